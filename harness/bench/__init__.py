"""The measurements of ``vfoa bench``, each with a baseline of its own in the same run."""
