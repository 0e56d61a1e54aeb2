# Prints the path of a Python of a version, as in: sh requirements/python.sh 3.12
# Looks along $PATH, then at those that pyenv has; PYTHON_3_12=/path/to/python3.12 names one.
version=$1
named=$(printenv "PYTHON_$(echo "$version" | tr . _)" || true)
for python in $named "python$version" "${PYENV_ROOT:-$HOME/.pyenv}"/versions/"$version".*/bin/python; do
  found=$("$python" -c 'import sys; print(sys.executable, *sys.version_info[:2])' 2>/dev/null) || continue
  if [ "${found#* }" = "$(echo "$version" | tr . ' ')" ]; then
    echo "${found% * *}"
    exit 0
  fi
done
echo "no Python $version along \$PATH or under pyenv; name it:" \
  "PYTHON_$(echo "$version" | tr . _)=/path/to/python$version" >&2
exit 1
