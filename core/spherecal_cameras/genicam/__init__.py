"""GenICam cameras through Harvesters: discovery, one process that owns all cameras, and the source made of both."""
