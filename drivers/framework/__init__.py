"""Building blocks of drivers: layouts of CAN messages and serial records, counters, checksums."""
