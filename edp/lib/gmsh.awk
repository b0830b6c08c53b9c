# gmsh.awk - what FreeFEM's readmesh takes, of a mesh in gmsh's format 2: triangles counterclockwise
# with their regions, their nodes, and the labelled edges between these. Points and curves apart
# from all surfaces, which help to draw, are left out.
#
# FreeFEM's own gmshload stops at triangles that run clockwise or are smaller than 1e-8 in the
# scene's units. What is wrong goes to the standard error, in a word: elements of another kind,
# nodes at different z, or the place where two nodes are.
/^[$]/ {part = $1}
part ~ /Nodes/ && NF == 4 {number[$1] = ++nodes; X[nodes] = $2; Y[nodes] = $3; Z[nodes] = $4}
part !~ /Elements/ || NF <= 4 {next}
$2 == 1 {
  first[++lines] = number[$(NF - 1)]; second[lines] = number[$NF]; label[lines] = $4
}
$2 == 2 {
  a = number[$(NF - 2)]; b = number[$(NF - 1)]; c = number[$NF]
  if ((X[b] - X[a])*(Y[c] - Y[a]) < (X[c] - X[a])*(Y[b] - Y[a])) {d = b; b = c; c = d}
  A[++triangles] = a; B[triangles] = b; C[triangles] = c; region[triangles] = $4
  used[a]; used[b]; used[c]
}
$2 != 1 && $2 != 2 && $2 != 15 {other = 1}
END {
  for (i = 1; i <= nodes; ++i) if (i in used) {
    at[i] = ++kept
    if (count[X[i], Y[i]]++ == 1) twice = "(" X[i] ", " Y[i] ")"
    if (kept == 1) {left = right = X[i]; low = high = Z[i]}
    if (X[i] < left) left = X[i]
    if (X[i] > right) right = X[i]
    if (Z[i] < low) low = Z[i]
    if (Z[i] > high) high = Z[i]
  }
  for (i = 1; i <= lines; ++i) edges += (first[i] in used) && (second[i] in used)
  print kept + 0, triangles + 0, edges + 0
  for (i = 1; i <= nodes; ++i) if (i in used) print X[i], Y[i], 0
  for (i = 1; i <= triangles; ++i) print at[A[i]], at[B[i]], at[C[i]], region[i]
  for (i = 1; i <= lines; ++i)
    if ((first[i] in used) && (second[i] in used)) print at[first[i]], at[second[i]], label[i]
  if (other) print "kind" > "/dev/stderr"
  else if (high - low > 1e-6*(right - left)) print "deep" > "/dev/stderr"
  else if (twice) print twice > "/dev/stderr"
}
