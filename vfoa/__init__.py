"""vfoa: the 3D Visual Focus of Attention pipeline. Arrays in, frozen values out.

Simões and Moreno, "3D estimation of visual focus of attention from stereo", ICARSC 2022.
"""
