# gmsh.awk - what FreeFEM's readmesh takes, of a mesh in gmsh's format 2: triangles counterclockwise
# with their regions, their nodes, and the labelled edges between these. Points and curves apart
# from all surfaces, which help to draw, are left out.
#
# `foreign`: the mesh was not made by gmsh just now, but is a file; `names`: a file to be written,
# with the names of the physical curves and surfaces.
#
# FreeFEM's own gmshload stops at triangles that run clockwise or are smaller than 1e-8 in the
# scene's units. What is wrong goes to the standard error, in a word or two: elements of another
# kind, nodes at different z, a physical curve that leads from triangles to where there are none,
# physical surfaces or curves that share elements, or the place where two nodes are.
/^[$]/ {
  part = $1 == "$Nodes" ? 1 : $1 == "$Elements" ? 2 : $1 == "$PhysicalNames" ? 3 : 0
  next
}
part == 3 && ($1 == 1 || $1 == 2) && NF > 2 {
  name = $0; sub(/^[^"]*"/, "", name); sub(/"[^"]*$/, "", name)
  gsub(/[\\"\t\r]/, "", name)  # no letters that a text in quotes cannot have
  named[$1, ++count_named[$1]] = $2 "\n" name
  next
}
part == 1 && NF == 4 {
  # numbers, as a text is turned into one each time it is used; places are printed as they are given
  number[$1 + 0] = ++nodes
  X[nodes] = $2 + 0; Y[nodes] = $3 + 0; Z[nodes] = $4 + 0; place[nodes] = $2 " " $3
  next
}
part != 2 || NF < 5 {next}
$2 == 2 {
  a = number[$(NF - 2) + 0]; b = number[$(NF - 1) + 0]; c = number[$NF + 0]
  # gmsh turns all triangles of a surface alike, others may not
  if (foreign || $5 != face) {
    x = X[a]; y = Y[a]; clockwise = (X[b] - x)*(Y[c] - y) < (X[c] - x)*(Y[b] - y)
  }
  if (clockwise) {d = b; b = c; c = d}
  triangle[++triangles] = a " " b " " c " " $4
  # gmsh numbers the nodes of curves first
  if (a <= last) delete bare[a]
  if (b <= last) delete bare[b]
  if (c <= last) delete bare[c]
  if ($5 != face || $4 != region) {
    again = again || ($5 in surface); surface[$5]; face = $5; region = $4
  }
  next
}
$2 == 1 {
  a = number[$(NF - 1) + 0]; b = number[$NF + 0]; bare[a]; bare[b]
  if (a > last) last = a
  if (b > last) last = b
  edge[++edges] = a " " b " " $4
  if ($5 != arc || $4 != label) {
    again = again || ($5 in curve); curve[$5]; arc = $5; label = $4
  }
  next
}
{if ($2 == 15) apart = 1; else other = 1}
function measure(  i, count) {
  # where the nodes are, and whether two are in one place
  left = right = X[1]; bottom = top = Z[1]; twice = ""
  for (i = 1; i <= nodes; ++i) {
    if (count[place[i]]++) {twice = "(" place[i] ")"; sub(" ", ", ", twice)}
    if (X[i] < left) left = X[i]
    if (X[i] > right) right = X[i]
    if (Z[i] < bottom) bottom = Z[i]
    if (Z[i] > top) top = Z[i]
  }
  return twice != "" || top - bottom > 1e-6*(right - left)
}
function leave_out(  i, at, used, n, part) {
  # the nodes that no triangle uses, and the edges that they end
  for (i = 1; i <= triangles; ++i) {
    split(triangle[i], part, " ")
    used[part[1]]; used[part[2]]; used[part[3]]
  }
  for (i = 1; i <= nodes; ++i)
    if (i in used) {at[i] = ++n; X[n] = X[i]; Z[n] = Z[i]; place[n] = place[i]}
  nodes = n
  for (i = 1; i <= triangles; ++i) {
    split(triangle[i], part, " ")
    triangle[i] = at[part[1]] " " at[part[2]] " " at[part[3]] " " part[4]
  }
  n = 0
  for (i = 1; i <= edges; ++i) {
    split(edge[i], part, " ")
    if (part[1] in at && part[2] in at) edge[++n] = at[part[1]] " " at[part[2]] " " part[3]
    else if (part[1] in at || part[2] in at) loose = "loose " part[3]
  }
  edges = n
}
function shared(  i, k, low, high, part, of, found) {
  # physical groups that have an element in common, if any
  for (i = 1; i <= triangles; ++i) {
    split(triangle[i], part, " ")
    low = high = part[1] + 0
    for (k = 2; k <= 3; ++k) {
      if (part[k] + 0 < low) low = part[k] + 0
      if (part[k] + 0 > high) high = part[k] + 0
    }
    low = low " " high " " (part[1] + part[2] + part[3])
    if (low in of) found = "surfaces " of[low] " and " part[4]
    of[low] = part[4]
  }
  for (i = 1; i <= edges; ++i) {
    split(edge[i], part, " ")
    low = part[1] + 0 < part[2] + 0 ? part[1] " " part[2] : part[2] " " part[1]
    if (low in of) found = "curves " of[low] " and " part[3]
    of[low] = part[3]
  }
  return found
}
END {
  # what stands apart costs no time where nothing says that there is any
  for (i in bare) apart = 1
  if (foreign) apart = 1
  if (measure() || apart) {leave_out(); measure()}
  for (kind = 1; names && kind <= 2; ++kind) {
    print count_named[kind] + 0 > names
    for (i = 1; i <= count_named[kind]; ++i) print named[kind, i] > names
  }
  print nodes + 0, triangles + 0, edges + 0
  for (i = 1; i <= nodes; ++i) print place[i], 0
  for (i = 1; i <= triangles; ++i) print triangle[i]
  for (i = 1; i <= edges; ++i) print edge[i]
  if (again) again = shared()
  if (other) print "kind" > "/dev/stderr"
  else if (top - bottom > 1e-6*(right - left)) print "deep" > "/dev/stderr"
  else if (loose) print loose > "/dev/stderr"
  else if (again) print again > "/dev/stderr"
  else if (twice) print twice > "/dev/stderr"
}
