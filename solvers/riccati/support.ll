; What code compiled by Numba asks of Numba's runtime, on memory of `wideberth_take`: references are
; counted by one thread, since arrays of a solve are its own; arrays that are reshaped are contiguous.
; The texts of exceptions, which only Python could read, are left out.

declare ptr @wideberth_take(i64)
declare void @wideberth_give(ptr)

define ptr @NRT_MemInfo_alloc(i64 %size) {
  %found = call ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 16)
  ret ptr %found
}

define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %step = zext i32 %align to i64
  %room = add i64 %step, 64
  %all = add i64 %size, %room
  %block = call ptr @wideberth_take(i64 %all)
  %none = icmp eq ptr %block, null
  br i1 %none, label %failed, label %made
made:
  %start = ptrtoint ptr %block to i64
  %behind = add i64 %start, 63
  %above = add i64 %behind, %step
  %mask = sub i64 0, %step
  %place = and i64 %above, %mask
  %data = inttoptr i64 %place to ptr
  %data.at = getelementptr i8, ptr %block, i64 24
  %size.at = getelementptr i8, ptr %block, i64 32
  store i64 1, ptr %block
  store ptr %data, ptr %data.at
  store i64 %size, ptr %size.at
  ret ptr %block
failed:
  ret ptr null
}

define void @NRT_MemInfo_call_dtor(ptr %block) {
  call void @wideberth_give(ptr %block)
  ret void
}

define void @NRT_incref(ptr %block) noinline {
  %none = icmp eq ptr %block, null
  br i1 %none, label %done, label %some
some:
  %held = load i64, ptr %block
  %more = add i64 %held, 1
  store i64 %more, ptr %block
  br label %done
done:
  ret void
}

define void @NRT_decref(ptr %block) noinline {
  %none = icmp eq ptr %block, null
  br i1 %none, label %done, label %some
some:
  %held = load i64, ptr %block
  %less = sub i64 %held, 1
  store i64 %less, ptr %block
  %last = icmp eq i64 %less, 0
  br i1 %last, label %drop, label %done
drop:
  call void @wideberth_give(ptr %block)
  br label %done
done:
  ret void
}

define ptr @NRT_Allocate(i64 %size) {
  %block = call ptr @wideberth_take(i64 %size)
  ret ptr %block
}

define void @NRT_Free(ptr %block) {
  call void @wideberth_give(ptr %block)
  ret void
}

define i32 @numba_attempt_nocopy_reshape(
    i64 %nd, ptr %dims, ptr %strides, i64 %count, ptr %lengths, ptr %found, i64 %item, i32 %order
) {
entry:
  %last = sub i64 %count, 1
  br label %next
next:
  %k = phi i64 [ %last, %entry ], [ %less, %write ]
  %stride = phi i64 [ %item, %entry ], [ %wider, %write ]
  %some = icmp sge i64 %k, 0
  br i1 %some, label %write, label %done
write:
  %found.at = getelementptr i64, ptr %found, i64 %k
  store i64 %stride, ptr %found.at
  %length.at = getelementptr i64, ptr %lengths, i64 %k
  %length = load i64, ptr %length.at
  %wider = mul i64 %stride, %length
  %less = sub i64 %k, 1
  br label %next
done:
  ret i32 1
}

@PyExc_RuntimeError = global ptr null

define void @PyErr_SetString(ptr %kind, ptr %text) {
  ret void
}

define ptr @PyUnicode_FromKindAndData(i32 %kind, ptr %data, i64 %size) {
  ret ptr null
}

define i64 @PyObject_Hash(ptr %one) {
  ret i64 0
}

define ptr @PyTuple_Pack(i64 %count, ...) {
  ret ptr null
}
