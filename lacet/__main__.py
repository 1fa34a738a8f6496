"""The command ``lacet``, and ``python -m lacet``."""

from __future__ import annotations

import sys

from lacet.services.commands.__main__ import main

if __name__ == "__main__":
    sys.exit(main())
