"""Earlier published methods that estimate the ambient from a phone's sensors, each from what is public of it."""
