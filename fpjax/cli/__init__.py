"""`fpjax COMMAND`: one file a command, imported only when it is asked for."""

from .command_line import main as main
