"""GenTL producers in C++ and the GigE cameras' wire protocol."""
