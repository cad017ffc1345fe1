"""Logs: what a machine recorded, read from the formats that people have, checked, in SI units."""

from .log import Log as Log
from .log import LogSource as LogSource
from .read import read_log as read_log
