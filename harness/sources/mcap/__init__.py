"""MCAP files: their records, their messages, and their growing end. What messages mean is in ``recordings``."""
