"""Recording: calibrations and logs from pictures, films, bags and data sets of an arm.

Hand-eye (camera and board from pictures and motions), in the order of the flow:
    handeye           the call that runs all below
    motion_tables     joints from a table, and the picture of each row
    documents         JSON and YAML
    pose_files        flange poses from tables, matrices, lists, JSON, NumPy
    board             patterns, and their corners in a picture
    board_pictures    the pictures that show a board, and the view of one camera
    lens              a camera's lens
    start             camera and board in closed form
    readings          what the numbers of poses mean
    refusals          joints and poses that are not of the pictures
    problem           all pictures, priors and the start
    bundle            predicted pixels and their slopes
    joint_motions     the flange by joints and a drawn arm
    fit               unknowns and sizes of noise
    agreement         the pictures that the fit rests on
    answer            places with intervals
    notes             remarks, and what limits the accuracy
    rig               the result as JSON, lines and a file
    next_poses        poses that improve it most
Tags and films (logs of a tag on the tip):
    pictures          pictures of a folder, frames of a video, a model's photo
    tags              tags and corners to .01 px
    reference         metres in a frame on the desk
    tag_scene         tag, reference and lens of a recording, and what pictures show
    track             how joints predict the tag: smooth functions, or a planar chain
    clocks            the sensor's clock against the joints'
    tag_logs          the log
    printing          tags and boards to scale
Bags and LeRobot:
    bags              ROS bags as logs
    lerobot           data sets as pictures and joints
"""
