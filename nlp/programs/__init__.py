"""Ipopt: its options, what it answers, and the room that it needs."""
