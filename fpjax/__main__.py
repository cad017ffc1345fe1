"""`python -m fpjax` is `fpjax`."""

import sys

from .cli.main import main

sys.exit(main())
