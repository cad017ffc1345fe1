"""The thesis, reproduced: every printed cell with its verdict, and its figures."""
