"""`fpjax COMMAND`: one file a command, imported only when it is asked for."""

from .main import main as main
