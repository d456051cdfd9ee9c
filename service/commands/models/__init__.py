"""Commands about models: identified, diagnosed, judged, and used to correct a program."""
