"""Logs of any acquisition system: names, units, rates and samples, whatever the format."""
