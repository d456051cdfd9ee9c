"""What only a ballbar needs in a run: lengths judged, cups placed as touched, the second stage."""
