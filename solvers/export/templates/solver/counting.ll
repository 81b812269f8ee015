
@next = internal global i64 0
@first = internal global i64 0

define void @begin(i64 %place) {
  store i64 %place, ptr @first
  store i64 %place, ptr @next
  ret void
}

define i64 @taken() {
  %first = load i64, ptr @first
  %next = load i64, ptr @next
  %count = sub i64 %next, %first
  ret i64 %count
}

define ptr @take(i64 %size) {
  %place = load i64, ptr @next
  %more = add i64 %size, {{ align - 1 }}
  %whole = and i64 %more, -{{ align }}
  %behind = add i64 %place, %whole
  %first = load i64, ptr @first
  %all = sub i64 %behind, %first
  %fits = icmp ule i64 %all, {{ room }}
  br i1 %fits, label %some, label %none
some:
  store i64 %behind, ptr @next
  %found = inttoptr i64 %place to ptr
  ret ptr %found
none:
  ret ptr null
}

define void @give(ptr %place) {
  ret void
}

define void @paint() noinline optnone "no-stack-arg-probe" {
entry:
  %room = alloca [{{ stack }} x i8], align 16
  br label %next
next:
  %k = phi i64 [ 0, %entry ], [ %more, %next ]
  %at = getelementptr i8, ptr %room, i64 %k
  store volatile i8 {{ paint }}, ptr %at
  %more = add i64 %k, 1
  %last = icmp eq i64 %more, {{ stack }}
  br i1 %last, label %done, label %next
done:
  ret void
}

define i64 @scan() noinline optnone "no-stack-arg-probe" {
entry:
  %room = alloca [{{ stack }} x i8], align 16
  br label %next
next:
  %k = phi i64 [ 0, %entry ], [ %more, %same ]
  %at = getelementptr i8, ptr %room, i64 %k
  %found = load volatile i8, ptr %at
  %painted = icmp eq i8 %found, {{ paint }}
  br i1 %painted, label %same, label %done
same:
  %more = add i64 %k, 1
  %last = icmp eq i64 %more, {{ stack }}
  br i1 %last, label %done, label %next
done:
  %touched = phi i64 [ %k, %next ], [ %more, %same ]
  %used = sub i64 {{ stack }}, %touched
  ret i64 %used
}

define i64 @measure(ptr %core, ptr %result, ptr %problem, ptr %table) noinline optnone {
  call void @paint()
  %status = call i32 %core(ptr %result, ptr %problem, ptr %table)
  %used = call i64 @scan()
  %none = icmp eq i32 %status, 1
  %found = select i1 %none, i64 -1, i64 %used
  ret i64 %found
}
