"""`python -m icjax`: the command line."""

import sys

from icjax.cli import main

sys.exit(main())
