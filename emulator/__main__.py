"""`python -m emulator` is the `heliograph` command."""

import sys

from emulator.cli import main

sys.exit(main())
