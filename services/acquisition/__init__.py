"""Acquisition: from wires and captures to logs and topics, live or replayed, with the transports that own the sockets."""
