"""The expert: contact plan, centroidal plan, whole-body plan, inverse dynamics, torques.

The stages follow each other in `schedule`, `footholds`, `centroidal`, `kinematics` and `planner`;
`expert` drives robots with the plans. Read `mpc.schedule` next.
"""
