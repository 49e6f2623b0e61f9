"""Devices that deliver a simulated recording while it happens, with faults where they are wanted.

device files -> device_logs -> faults -> plc   (ring buffer behind an ADS server)
                                      -> egm   (messages of the robot's controller over UDP)
                                      -> device_logs.GrowingRecording (files that grow)
"""
