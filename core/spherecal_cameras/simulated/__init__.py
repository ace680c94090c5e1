"""A simulated rig as live cameras: for demonstration, training and tests. The label says so wherever it is used."""
