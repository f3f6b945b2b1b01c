#!/bin/sh
# Takes the estimate into a kernel thermal zone, for engines that know kernel zones only (Qualcomm's thermal-engine).
# For the lab: it needs root and a kernel with CONFIG_THERMAL_EMULATION, and below its critical trip the zone's own
# sensor is no longer heard.
#
#   emul_temp.sh ESTIMATE ZONE_TYPE MISSING_MILLIDEGC [PERIOD_S]
#
# ESTIMATE           a file that ambientd publishes with file:PATH
# ZONE_TYPE          the type of the zone that is to say it
# MISSING_MILLIDEGC  what the zone says while there is no estimate, and after this script has ended: choose it so that
#                    the engine then does what is safe
# PERIOD_S           how often (default: 1)
#
# A 0 would switch the emulation off and let the zone's own sensor speak instead: 0.000 degC is said as 0.001.
# To switch it off for good: echo 0 > /sys/class/thermal/thermal_zoneN/emul_temp
set -u

oldest_s=30 # an estimate that has not been renewed for as long is none; the slowest daemon renews it every 10 s

fail() {
    echo "emul_temp: $2" >&2
    exit "$1"
}

is_integer() {
    case ${1#-} in
    '' | *[!0-9]* | ?????????????*) return 1 ;;
    esac
}

find_zone() {
    for type_file in "${SYSFS_ROOT:-/sys}"/class/thermal/thermal_zone*/type; do
        if [ -r "$type_file" ] && IFS= read -r found <"$type_file" && [ "$found" = "$1" ]; then
            echo "${type_file%/type}/emul_temp"
            return
        fi
    done
    return 1
}

# The millidegrees that are to be said now.
current() {
    value=
    # one from the future has not been renewed since the clock was set back
    if changed_s=$(stat -c %Y "$estimate" 2>/dev/null) && age_s=$(($(date +%s) - changed_s)) &&
        [ "$age_s" -le "$oldest_s" ] && [ "$age_s" -ge -1 ]; then
        { IFS= read -r value <"$estimate"; } 2>/dev/null
    fi
    is_integer "$value" || value=$missing
    # whatever way a zero is written: 0, -0, 000
    case ${value#-} in
    *[!0]*) echo "$value" ;;
    *) echo 1 ;;
    esac
}

say() {
    if { echo "$1" >"$target"; } 2>/dev/null; then
        [ -z "$silent" ] || echo "emul_temp: $target: is back" >&2
        silent=
    else
        [ -n "$silent" ] || echo "emul_temp: $target: cannot be written; trying on" >&2
        silent=yes
    fi
}

[ $# -eq 3 ] || [ $# -eq 4 ] || fail 2 "usage: emul_temp.sh ESTIMATE ZONE_TYPE MISSING_MILLIDEGC [PERIOD_S]"
estimate=$1
missing=$3
silent=
is_integer "$missing" || fail 2 "MISSING_MILLIDEGC is '$missing'; an integer in millidegrees is wanted"
[ "$missing" -ne 0 ] || fail 2 "MISSING_MILLIDEGC is 0, which would switch the emulation off; choose another"
case ${4:-1} in
*[!0-9.]* | *.*.* | .) fail 2 "PERIOD_S is '$4'; a number of seconds is wanted" ;;
*[1-9]*) period_s=${4:-1} ;;
*) fail 2 "PERIOD_S is '$4'; more than 0 is wanted" ;;
esac
target=$(find_zone "$2") || fail 1 "no thermal zone of type '$2'"
[ -w "$target" ] || fail 1 "$target: cannot be written; be root, on a kernel with CONFIG_THERMAL_EMULATION"

trap 'say "$missing"; exit 0' TERM INT HUP
while :; do
    say "$(current)"
    sleep "$period_s" &
    wait $! # unlike sleep itself, a signal ends it at once
done
