# shellcheck shell=sh
# Sourced by Magisk while it installs the module, with MODPATH set. The configuration and the model live outside the
# module, where an update leaves them alone.
settings=/data/adb/ambientd
mkdir -p "$settings"
[ -e "$settings/ambientd.json" ] || cp "$MODPATH/ambientd.json" "$settings/ambientd.json"
[ -e "$settings/model.json" ] || ui_print "- copy your model to $settings/model.json, then restart"
