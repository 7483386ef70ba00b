# Sourced by tools/demo and tools/test: installs what a fresh machine lacks, after saying what and, where root is needed and
# we are not root, after asking. Reads nothing from standard input.

say() { printf '\n== %s\n' "$*"; }
stop() { printf 'error: %s\n' "$*" >&2; exit 1; }

# Usage: timed NAME COMMAND...   Runs a stage and prints how long it took.
timed() {
    local name=$1 begin=$SECONDS
    shift
    say "$name"
    "$@" || stop "stage '$name' failed after $((SECONDS - begin)) s: $*"
    printf -- '-- %s: %d s\n' "$name" "$((SECONDS - begin))"
}

# Debian's and Ubuntu's names of the packages for a build.
build_packages=(g++ pkg-config libshaderc-dev glslang-dev spirv-tools)

# Usage: install_missing PACKAGE...
install_missing() {
    local missing=() package
    if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
        echo "This is no Debian: its packages are not installed here. Needed are a C++ compiler, the Vulkan loader and a"
        echo "driver, and shaderc with glslang and SPIRV-Tools as libraries (or build with --features shaderc-from-source)."
        return
    fi
    for package in "$@"; do
        # shellcheck disable=SC2016 # dpkg-query's own format
        [ "$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null)" = installed ] || missing+=("$package")
    done
    if [ ${#missing[@]} -eq 0 ]; then
        echo "Nothing to install: every package is there."
        return
    fi
    echo "To be installed with apt-get: ${missing[*]}"
    local root=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || stop "not root, and no sudo. As root: apt-get install --no-install-recommends ${missing[*]}"
        root=(sudo)
        if [ "${CI:-}" != true ]; then
            local answer=
            printf 'This needs root (sudo). Go on? [y/N] '
            { read -r answer </dev/tty; } 2>/dev/null || echo '(no terminal to ask on)'
            case $answer in
                y | Y | yes) ;;
                *) stop "nothing was installed. To do it yourself: sudo apt-get install --no-install-recommends ${missing[*]}" ;;
            esac
        fi
    fi
    # Chained with &&: a stage runs where bash does not stop at a failing command.
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get update -qq </dev/null &&
        "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" </dev/null
}

# A driver is installed only if there is none.
has_vulkan_driver() {
    local folder
    for folder in /usr/share/vulkan/icd.d /etc/vulkan/icd.d /usr/local/share/vulkan/icd.d; do
        compgen -G "$folder/*.json" >/dev/null && return 0
    done
    [ -n "${VK_ICD_FILENAMES:-}${VK_DRIVER_FILES:-}" ]
}

# The compiler has to be as new as Cargo.toml says; that of Debian 12 is too old.
check_rust() {
    local need have
    need=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
    if ! command -v cargo >/dev/null && [ -x "$HOME/.cargo/bin/cargo" ]; then
        PATH=$HOME/.cargo/bin:$PATH
    fi
    have=$(cargo --version 2>/dev/null | cut -d' ' -f2 || true)
    if [ -z "$have" ] || [ "$(printf '%s\n' "$need" "$have" | sort -V | head -n1)" != "$need" ]; then
        echo "Rust $need or newer is needed; found: ${have:-none}. Install it for your user, without root, from https://rustup.rs:" >&2
        echo "    curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs | sh" >&2
        echo "or, where rustup is there already: rustup update stable" >&2
        exit 1
    fi
    echo "Rust $have (at least $need is needed). Crates are downloaded by cargo as Cargo.lock names them."
}
