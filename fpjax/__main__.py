"""`python -m fpjax` is `fpjax`."""

import sys

from .cli import main

sys.exit(main())
