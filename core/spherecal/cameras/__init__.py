"""Live cameras: one protocol (protocol.py), and behind it GenICam cameras, recorded sessions or a simulated rig.

GenICam runs in a process of its own (genicam_source.py); `harvesters` and `genicam` are imported nowhere else.
"""
