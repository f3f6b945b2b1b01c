"""Ten units of a simulated fleet that differ from the others, each by one effect."""

PLANTED = (
    "sensor_bias:usb:4K:from=0:to=end",
    "sensor_bias:display:-4K:from=0:to=end",
    "sensor_bias:battery:4K:from=0:to=end",
    "sensor_gain:display:10%",
    "sensor_drift:usb:6K/h",
    "ambient_coupling:all:-40%:from=0:to=end",
    "ambient_coupling:back:-60%:from=0:to=end",
    "heat_source:board2:2W:from=0:to=end",
    "contact:back:0.2W/K:body=hand:from=0:to=end",
    "path:flash-usb:0.2W/K:from=0:to=end",
)
