"""The workbench: a local web page on a study, and the server behind it (``docs/workbench.md``)."""
