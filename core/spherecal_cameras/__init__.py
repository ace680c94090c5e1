"""Live cameras: one protocol, and behind it GenICam cameras in a process of their own, recorded or simulated ones."""
