"""Effects of the transmission of a turning joint: gears, play, friction, the encoder, drives through other joints."""
