"""The watch: is a robot still the one that was calibrated; what has changed, by how much, and what to do."""
