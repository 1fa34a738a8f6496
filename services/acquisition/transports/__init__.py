"""Transports between wires and `Frames`: the only modules with sockets, serial lines and receipt stamps."""
