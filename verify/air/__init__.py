"""Air speed by a jet model: what rotors blow at points, over regions and at each other."""
