"""`python -m fpjax` runs the command `fpjax`."""

import sys

from .cli import main

sys.exit(main())
