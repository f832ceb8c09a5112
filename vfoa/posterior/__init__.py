"""The posterior over a person's targets, with an unknown error of the measured directions.

grid    the hypotheses about the error and the head, and their prior
looks   how long people look at a target, and how often at none
kalman  how far the gaze is off and where the head is on its way to: a filter for each target and hypothesis
belief  what is believed of a person, and what is seen and measured in a frame
cues    where each hypothesis expects gaze and head, and what the measured ones say
filter  Bayes' rule over targets and hypotheses: frame by frame, and with later frames known
"""
