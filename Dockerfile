# docker build -t oed . ; docker run --rm -v "$PWD:/work" oed run studies/ur10.yaml
FROM python:3.12-slim
ENV OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MPLBACKEND=Agg
WORKDIR /source
COPY . .
RUN pip install --no-cache-dir '.[records,control,xacro]'
WORKDIR /work
ENTRYPOINT ["oed"]
CMD ["--help"]
