"""A design in closed loop in MuJoCo: evidence from a simulation, beside the audit and never in its place.

MuJoCo knows rigid bodies and contacts. Of downwash it knows the thrust that rotors lose to wakes, by the audit's
air model: the airflow envelopes are the model of all else.
"""
