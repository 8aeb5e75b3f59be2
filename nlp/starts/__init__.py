"""Starts: random ones, untangled if there are many modules, and ones from other designs."""
