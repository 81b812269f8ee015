; Where a library of the core takes its memory: from the C library.

declare ptr @malloc(i64)
declare void @free(ptr)

define hidden ptr @wideberth_take(i64 %size) {
  %found = call ptr @malloc(i64 %size)
  ret ptr %found
}

define hidden void @wideberth_give(ptr %block) {
  call void @free(ptr %block)
  ret void
}
