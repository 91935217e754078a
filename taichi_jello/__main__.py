"""`python -m taichi_jello` is `jello`."""

import sys

from taichi_jello.app.cli import main

sys.exit(main())
