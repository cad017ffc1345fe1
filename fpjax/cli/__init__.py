"""`fpjax COMMAND`: one module for each command, imported only when that command is called."""

from .command_line import main as main
