"""The lab kit: everything that it takes to build a design and to put it in the air, in one folder."""
