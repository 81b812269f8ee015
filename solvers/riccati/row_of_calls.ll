; Calls an entry of the core for a row of tables, until a status is not 0.

define i32 @wideberth_row_of_calls(ptr %entry, ptr %scratch, ptr %tables, i64 %count) {
begin:
  %other = getelementptr i64, ptr %scratch, i64 1
  br label %next
next:
  %i = phi i64 [ 0, %begin ], [ %following, %go ]
  %following = add i64 %i, 1
  %more = icmp slt i64 %i, %count
  br i1 %more, label %go, label %done
go:
  %place = getelementptr ptr, ptr %tables, i64 %i
  %table = load ptr, ptr %place
  %status = call i32 %entry(ptr %scratch, ptr %other, ptr %table)
  %well = icmp eq i32 %status, 0
  br i1 %well, label %next, label %ill
ill:
  ret i32 %status
done:
  ret i32 0
}
