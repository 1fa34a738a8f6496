"""Acquisition: from wires and captures to logs and topics, live or replayed; its transports own the sockets."""
