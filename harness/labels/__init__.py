"""Labels: their files, strict reading and writing, time and frames, several annotators, formats of other programs."""
