"""Logs of what a robot measured, replayed through its policy to show what differs, and how."""
