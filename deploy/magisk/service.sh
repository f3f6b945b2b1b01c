#!/system/bin/sh
# Started by Magisk, as root, once the phone is up: keeps the daemon running until the module is disabled or removed.
module=${0%/*}
settings=${AMBIENTD_SETTINGS:-/data/adb/ambientd}
run=${AMBIENTD_RUN:-/dev/ambientd} # in memory: a file that changes every second has no business on the flash
pause_s=${AMBIENTD_PAUSE_S:-10}
log=$run/log

umask 022
mkdir -p "$run"

# Android has no Python of its own: one put into the settings folder, or Termux's.
find_python() {
    for python in "$settings/python/bin/python3" /data/data/com.termux/files/usr/bin/python3; do
        if [ -x "$python" ]; then
            echo "$python"
            return
        fi
    done
    return 1
}

while [ -e "$module/ambientd.pyz" ] && [ ! -e "$module/disable" ] && [ ! -e "$module/remove" ]; do
    # the log of the last start only, so that it cannot fill the memory
    if python=$(find_python); then
        "$python" -I -S "$module/ambientd.pyz" run --config "$settings/ambientd.json" >"$log" 2>&1
        echo "ambientd ended with status $?; once more in $pause_s s" >>"$log"
        # one that was killed leaves its last value
        "$python" -I -S "$module/ambientd.pyz" withdraw --config "$settings/ambientd.json" >>"$log" 2>&1
    else
        echo "no Python in $settings/python/bin/python3 nor in Termux; looking again in $pause_s s" >"$log"
    fi
    sleep "$pause_s"
done
