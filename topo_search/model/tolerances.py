"""Required accuracy of a design: the audit and the proofs use the same numbers, so that they agree."""

TOLERANCE = 1e-6
"""Largest deviation of a clear design, in units of its scale.

Forces in m_t g; torques in l_arm m_t g, about the COM and about p_E; inputs in the largest allowed one; lengths in
l_arm; the objective relative to itself; angles in rad.
"""
FARTHEST = 100.0
"""Farthest that p_E may be from the COM, in lengths of the platform stretched out.

Far beyond, the COM itself is far from every rotor, and forces within the tolerance make up for torques.
"""
