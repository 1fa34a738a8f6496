"""Where the command ``lacet`` (and ``python -m services``) begins: the environment is checked before it is used."""

from __future__ import annotations

import sys

from services import environment


def main() -> int:
    """Run the command line. Returns its exit code, or 2 when foreign packages hide lacet's own."""
    status = environment.main()
    if status:
        return status
    from services.cli import main as run  # only now: importing it needs every package of lacet

    return run()


if __name__ == "__main__":
    sys.exit(main())
