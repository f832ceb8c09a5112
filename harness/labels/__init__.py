"""Labels: the files, their strict reading and writing, time and frames, several annotators and their agreement."""
