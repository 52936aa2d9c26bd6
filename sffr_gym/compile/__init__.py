"""The compiler's side of the kernels: their decorator and cache, kinds of number, and small linear algebra."""
