"""Acquisition: from wires and captures to logs and the bus, live or replayed; its transports own the sockets."""
