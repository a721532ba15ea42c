"""Readers of files as laboratories have them: one file each, and one line in `dispatch`."""
