"""What may be wrong with a rig or a recording, told from the solved network: one file a fault."""
