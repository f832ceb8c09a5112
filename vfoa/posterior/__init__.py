"""The posterior over what a person looks at, with the error of the measured directions unknown.

settings    what is assumed: priors, and how people move
grid        the hypotheses about the error and the head, and their prior
gaze_error  how far the measured gaze is off, by hypothesis and target
head_motion where the head is on its way to, by hypothesis and target
looks       how long people look at a target, and how often at none
filter      one frame: all of the above, and Bayes' rule over targets and hypotheses
smoothing   the same with later frames known
"""
