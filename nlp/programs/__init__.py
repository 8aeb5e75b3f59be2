"""Ipopt: its options, what it returns, and the room that it needs."""
