"""Points to start from: at random, untangled first where modules are many, or from another design."""
