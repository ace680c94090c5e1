"""What may be wrong with a rig or a recording, from the solved network: one file per fault."""
