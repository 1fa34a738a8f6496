"""Bus (Zenoh): publication and reception of decoded blocks over the network, through bounded queues."""
