"""Effects of slides: linear axes that carry the arm or its tool."""
