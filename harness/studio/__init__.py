"""The studio: rendered stereo clips of people at a table, with exact ground truth. They need no download.

scenario      seats, positions of objects, and looks: data
gathering     randomly drawn scenarios
choreography  fixations, saccades, heads that follow: poses at each frame
mesh, material, things, people    shapes and paint
raycast       the surface that a ray hits, its paint and its light
stage         a scenario in metres: the room, bodies, boxes, heads, eyes, gaze
render        the two cameras and their sensors; lines of sight
store         rendered frames on disk
clip          the adapter
"""

from harness.studio.clip import StudioClip, StudioSettings

__all__ = ["StudioClip", "StudioSettings"]
