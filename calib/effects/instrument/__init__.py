"""Effects of the instrument and its reference: its scale, its drift, a displaced base target."""
