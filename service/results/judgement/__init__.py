"""Results of a judgement: a model compared with held-out readings, and limits of acceptance."""
