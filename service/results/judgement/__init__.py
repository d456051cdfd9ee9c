"""Results of a judgement: a model held against readings that took no part, and limits for acceptance."""
