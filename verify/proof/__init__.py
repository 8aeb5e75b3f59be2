"""The check of a proof by branch and bound: it shares no code with the prover and takes only the splits from it.

`verify.proof.platform` has the task as arrays, `arcs` the theorem that vertices suffice, `dual` and `crowded` the
two reasons to exclude a box, `rod` the loss of a bound to rods with mass, `replay` the walk through a record,
`check` the check of a chunk.
"""
