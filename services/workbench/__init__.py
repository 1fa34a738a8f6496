"""Workbench: a local web page on a study, and its server (``docs/workbench.md``)."""

from lacet.daq.parts import require

require("ui")
