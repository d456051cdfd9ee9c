"""What a run asks a person to do, and the answers."""
