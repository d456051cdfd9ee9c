"""Effects of temperature: of the air, and of the heat that the arm makes by itself."""
