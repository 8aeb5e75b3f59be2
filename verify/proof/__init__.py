"""The check of a proof by branch and bound: it shares no code with what proved it, and takes its splits alone.

`verify.proof.platform` states the task, `arcs` why corners are enough, `dual` and `nearness` the two reasons for
which a box is dropped, `replay` goes through a record, `check` says what came of it.
"""
