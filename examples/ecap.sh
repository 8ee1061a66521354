# What the examples share: e-CAP by curl alone. Sourced by them; URL is the server, as http://127.0.0.1:8080
# サンプルの共通部分: curl だけで e-CAP を使う。URL は http://127.0.0.1:8080 などのサーバ

url=${1:?usage: sh $0 URL, as http://127.0.0.1:8080}
token=${ORINKIT_TOKEN:+"Authorization: Bearer $ORINKIT_TOKEN"}

# call FUNCTION ARGUMENT...: prints the call and its reply; the result is in $result. Ends the script if it fails.
call() {
    body="Func=$1"
    shift
    number=1
    for argument in "$@"; do
        body="$body,Arg$number=$argument"
        number=$((number + 1))
    done
    reply=$(curl -sS --fail-with-body ${token:+-H "$token"} --data-binary "$body" "$url") || {
        echo "$body -> ${reply:-no answer}" >&2
        exit 1
    }
    echo "$body -> $reply"
    case $reply in
        0x8*) exit 1 ;; # a return code that says error
    esac
    result=${reply#*,}   # behind the return code: 3,2
    value=${result#*,}   # behind the type: 2
}
