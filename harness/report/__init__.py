"""Tables and pages, from results and scores alone: no images, no models."""
