"""What drivers are made of: layouts of CAN messages and serial records, counters, checksums."""
