"""The live recorder: what a PLC and a robot controller deliver, into a recording folder.

    PLC ring buffer --ADS--> ring -> plc_source \
                                                 recorder -> folder -> DIR/raw/...
    robot controller --UDP--------> egm_source  /                   -> DIR/recording.yaml

Nothing is interpreted on the way: counters, status words, stamps and EGM messages are stored as the
devices made them. After the recorder of thesis sec. 4.6.
"""
