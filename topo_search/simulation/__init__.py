"""A design in closed loop in MuJoCo: evidence from a simulation, beside the audit and never in its place.

MuJoCo knows rigid bodies and contacts. It knows nothing of downwash: the airflow envelopes are the model of that.
"""
