"""The bus: decoded blocks published and received over Zenoh, through bounded queues."""
