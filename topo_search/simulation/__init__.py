"""Closed-loop simulation of a design in MuJoCo: evidence in addition to the audit, never a substitute for it.

MuJoCo simulates rigid bodies and contacts. The only effect of downwash in it is the thrust that rotors lose to
wakes, by the audit's air model; the airflow envelopes cover all others.
"""
