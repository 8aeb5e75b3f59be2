"""Air speeds by a jet model: at points, over regions and through rotors."""
