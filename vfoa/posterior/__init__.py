"""The posterior over a person's targets, with an unknown error of the measured directions.

assumptions what several parts assume about errors and heads
grid        the hypotheses about the error and the head, and their prior
belief      what is believed of a person, and what is seen and measured in a frame
gaze_error  how far the measured gaze is off, by hypothesis and target
head_motion where the head is on its way to, by hypothesis and target
looks       how long people look at a target, and how often at none
aims        where each hypothesis expects gaze and head, and how far the measured ones are from there
gaze_cue    what the gaze of one frame says; head_cue: what the head says; evidence: what both give
filter      one frame: all of the above, and Bayes' rule over targets and hypotheses
smoothing   the same with later frames known
"""
