"""Workbench: a local web page on a study, and its server (``docs/workbench.md``)."""
