"""Designs for other eyes and tools: pictures and files of other formats."""
