"""A second opinion: quasi-static ball-bar recordings by code that shares nothing with this project.

Kinematics by products of exponentials, equilibrium of servo, gears, bearings, rod and plate solved
sample by sample, sensors and files of its own. Only the numbers of the YAML files under cell/ are
read, as plain YAML. Where reality could differ from sim/, this does: Dahl friction, hysteretic
backlash, phase-modulated ripple, sine and cosine signals with offsets, a clock that drifts, and
errors in everything that the identifier holds for uncertain.
"""
