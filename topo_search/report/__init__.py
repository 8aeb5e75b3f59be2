"""The page that a run ends in: one file that opens without a network, for a run or for a single audited design."""
