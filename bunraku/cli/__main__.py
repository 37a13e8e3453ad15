"""`python -m bunraku.cli`: the command without its script."""

import sys

from bunraku.cli import main

sys.exit(main())
