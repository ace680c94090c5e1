"""Live cameras: one protocol (protocol.py), and behind it GenICam cameras, recorded sessions or a simulated rig.

GenICam runs in a process of its own (gentl/child.py); `harvesters` and `genicam` are imported by gentl only.
"""
