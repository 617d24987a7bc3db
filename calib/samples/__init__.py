"""Samples: what the arm did and what the sensor saw, simulated or read from logs.

In the order of a log's way from a file to `Samples`:

- `settings`: numbers that were chosen, with their reasons
- `motion`, `samples`: arrays row by row, poses and visits; `Samples`, what all others make or use
- `simulation`: babbling of an arm, with what changed
- `tables`, `column_units`, `roles`: files; names and units of columns; which column is what
- `cells`, `joint_values`, `locked_joints`: sound rows; joints in their ranges; those that rest
- `sockets`, `camera`, `lens`: touches; the camera that pixels come from
- `logs`: `read_log`, which goes through all of these
- `misfit`, `findings`, `diagnosis`: mistakes that the arm's kinematics show
- `repeatability`, `delays`: noise from repeated poses; a clock that is late
- `batch`: tables of queries
"""
