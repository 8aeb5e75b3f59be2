"""The inner problem: the best angles, end-effector position and rotor inputs of one topology."""
