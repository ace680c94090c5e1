#!/usr/bin/env bash
# publish_site.sh VERSION SITE REMOTE: the manual as folder VERSION of the branch gh-pages, whose first page leads to it.
set -euo pipefail
version=$1 site=$(realpath "$2") remote=$3
pages=$(mktemp -d)
git clone --quiet --depth 1 --branch gh-pages "$remote" "$pages" 2>/dev/null || git init --quiet --initial-branch gh-pages "$pages"
rm -rf "${pages:?}/$version"
cp -r "$site" "$pages/$version"
printf '<!doctype html><meta http-equiv="refresh" content="0; url=%s/index.html">\n' "$version" > "$pages/index.html"
touch "$pages/.nojekyll"
cd "$pages"
git add --all
git -c user.name=release -c user.email=release@localhost commit --quiet --message "Manual of $version"
git push --quiet "$remote" HEAD:gh-pages
