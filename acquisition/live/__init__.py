"""The live recorder: what a PLC and a robot controller deliver, into a recording folder as it comes (thesis sec. 4.6).

    PLC ring buffer --ADS--> ring -> plc_source \
                                                 recorder -> segment_file -> DIR/raw/..., folder -> DIR/recording.yaml
    robot controller --UDP--------> egm_source  /

Nothing is interpreted on the way: counters, status words, stamps and EGM messages are kept as the devices made them.
"""
